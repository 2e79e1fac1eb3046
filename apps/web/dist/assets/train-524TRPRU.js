import"./chunk-QM3DQEVC.js";import{O as t,y as i}from"./chunk-IZNNYOB3.js";function n(){return i(t,{title:"Train",text:"This page is being built."})}export{n as Train};
