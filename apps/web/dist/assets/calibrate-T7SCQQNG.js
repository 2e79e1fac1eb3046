import"./chunk-QM3DQEVC.js";import{O as e,y as t}from"./chunk-IZNNYOB3.js";function a(){return t(e,{title:"Calibrate",text:"This page is being built."})}export{a as Calibrate};
