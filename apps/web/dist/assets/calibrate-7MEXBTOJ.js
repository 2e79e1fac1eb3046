import"./chunk-KHNENPYX.js";import{O as e,y as t}from"./chunk-EXJ3EDRR.js";function a(){return t(e,{title:"Calibrate",text:"This page is being built."})}export{a as Calibrate};
