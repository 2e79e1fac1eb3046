import"./chunk-QM3DQEVC.js";import{O as t,y as e}from"./chunk-IZNNYOB3.js";function o(){return e(t,{title:"People",text:"This page is being built."})}export{o as People};
